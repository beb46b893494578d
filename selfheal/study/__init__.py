"""Studies: a table of the papers in, many runs on many cores, the table out."""
