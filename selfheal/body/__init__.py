"""Bodies and genomes: takes encodings, gives bodies, their distances and their MJCF."""
