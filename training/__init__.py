"""Learning from flights, and judging what was learned."""
