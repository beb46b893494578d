"""What a controller does that the model does not say: it carries weight, it waits."""
