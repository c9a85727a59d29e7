"""Scenarios, wiring, flights, logs and pictures: everything between the blocks and the commands."""
