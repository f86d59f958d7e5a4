"""Training: examples from windows, the loss of an unrolled prediction, and a loop that survives being killed."""
