"""What the estimators are made of: hypotheses, Sampson distances, refinement, batches of views."""
