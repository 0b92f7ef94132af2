"""The paper's figures 1 to 5 on a reproduction's own data and networks, and figure 6 with ours."""
