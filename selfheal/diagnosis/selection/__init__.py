"""Model selection: which effects the data support, tested on held-out episodes."""
