"""What follows from draws of the parameters: predictions and derived quantities."""
