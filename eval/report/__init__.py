"""Reports of an evaluation: tables, figures and report.html."""
