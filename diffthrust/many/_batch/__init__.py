"""Many members of one model, arranged and run together."""
