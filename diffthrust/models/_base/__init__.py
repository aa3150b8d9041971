"""What models and effects are made of: parameters, signals, ports."""
