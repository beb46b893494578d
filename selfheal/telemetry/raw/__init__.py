"""What raw columns tell before any motion is computed: readings in, faults out."""
