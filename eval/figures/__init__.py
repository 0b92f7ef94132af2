"""Pictures of results for papers, with Matplotlib."""
