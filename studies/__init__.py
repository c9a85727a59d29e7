"""Many flights and what they show: what is flown, its figures, and one report."""
