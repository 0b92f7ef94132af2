"""Plans of ``glsim reproduce``: one TOML file per size, described in glsim/cli/reproduce.py."""
