"""
Routes: a way driven once, kept as photographs with the structure between them, and repeated.

Each key view is a photograph with features whose depths are known, and the taught path as that
very structure shows it: errors of the structure are the same when the path is repeated.
"""
