"""What is wrong with the files of a data set: checks, one kind a file, their report, and the safe repairs."""
