"""A sweep in figures and tables: starts on a map, errors as histograms, rates by law."""
