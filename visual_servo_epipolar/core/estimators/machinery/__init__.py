"""Parts of the estimators: hypotheses, Sampson distances, refinement, batches of views."""
