"""What no robot needs: the product measured, broken on purpose and held against the paper."""
