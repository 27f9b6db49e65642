"""Speed: what images, steps, loops and whole demos cost, beside a floor in the same run."""
