"""Search of a geometry without earlier bearings, or where none fit."""
