"""What predictions are worth: metrics, the noise floor, and results in one format."""
