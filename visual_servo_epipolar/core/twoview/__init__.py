"""Two views: estimators of their epipoles, the gates an estimate must pass, two photographs."""
