"""Studies: measurements with a report, tables, figures and their data."""
