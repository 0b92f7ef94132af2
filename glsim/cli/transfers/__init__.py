"""Studies of ``glsim transfer`` (keys: eval/transfer/study.py), and its steps."""
