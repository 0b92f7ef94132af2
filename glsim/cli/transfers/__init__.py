"""Studies of ``glsim transfer`` (keys: glsim/eval/transfer/study.py), and its steps."""
