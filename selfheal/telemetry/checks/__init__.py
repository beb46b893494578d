"""One module a check: `find(context)` gives the faults that it finds."""
