"""What ``glsim reproduce`` runs: a TOML file a size, described in glsim/cli/reproduce.py."""
