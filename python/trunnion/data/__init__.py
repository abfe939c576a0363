"""Containers of measured data, one file a kind, and the readers and writers of their files."""
