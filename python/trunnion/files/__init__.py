"""File formats: CSV with typed columns, TOML with positions; errors name file, line and column."""
