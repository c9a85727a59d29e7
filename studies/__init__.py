"""Many flights and what they show."""
