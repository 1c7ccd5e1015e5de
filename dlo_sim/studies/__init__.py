"""Studies: measurements with a report, tables, figures and their data; the only plots besides the
demo's."""
