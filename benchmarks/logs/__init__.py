"""How fast logs are read, and in how much memory."""
