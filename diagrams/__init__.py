"""Scenarios, wiring, flights, logs and pictures, made of the systems in `proxops.systems`."""
