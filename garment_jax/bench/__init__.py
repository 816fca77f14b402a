"""Every method trained, rolled out and measured on one data set: error against run time, in one report."""
