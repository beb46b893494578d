"""Logs as people have them: takes their files, gives recordings of the contract."""
