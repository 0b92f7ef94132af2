"""Plans of ``glsim paper reproduce``: one TOML file per size, described in its module."""
