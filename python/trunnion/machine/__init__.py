"""The machine: what is wrong with it, and what a measurement says of that."""
