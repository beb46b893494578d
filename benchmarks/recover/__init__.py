"""Recovery of legged robots over many seeds, by three methods."""
