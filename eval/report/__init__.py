"""Reports of an evaluation: tables, figures, report.html."""
