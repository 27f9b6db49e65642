"""Figures, tables, pages and videos of runs. Reads a RunLog, imports core alone."""
