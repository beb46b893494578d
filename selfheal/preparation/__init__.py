"""Preparation: takes a URDF or MJCF, gives an MJCF whose joints are driven."""
