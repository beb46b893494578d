"""Readers of file formats of logs: takes paths, gives logs."""
