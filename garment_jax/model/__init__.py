"""The networks of the paper and the column RNN, composed into one step; models on disk."""
