"""Self-models: what a robot felt in, the bodies that would explain it out."""
