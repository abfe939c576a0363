"""Generators of the samples that come with the package; each file says what it makes."""
