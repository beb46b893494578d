"""Output: diagnosis.json, patched.xml, and the replay of both."""
