"""Logs for other tools: MCAP, which Foxglove and others play, and CCSDS OEM.

Start with `write_mcap` and `write_oem`; each takes a `FlightLog`. Their packages come with the
extra `exchange`. A new format is a module of its own here.
"""

from proxops.diagrams.exchange.mcap_file import write_mcap
from proxops.diagrams.exchange.oem_file import EPOCH, write_oem

__all__ = ["EPOCH", "write_mcap", "write_oem"]
