"""Self-models: readings of a robot in, the bodies that would explain it out."""
