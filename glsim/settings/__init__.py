"""Settings of a run: the schema, distributions, TOML tables and seeds."""
