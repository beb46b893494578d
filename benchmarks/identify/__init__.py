"""Success of identification over many seeds, for each method and robot."""
