"""The contract that a room is entered by its face alone, for import-linter."""

from grimp import ImportGraph
from importlinter import Contract, ContractCheck
from importlinter.application import output


def room_of(module: str) -> str | None:
    """`proxops.FOLDER.ROOM` of a module inside a room; None: it is a face, or in no room."""
    parts = module.split(".")
    return ".".join(parts[:3]) if parts[0] == "proxops" and len(parts) > 3 else None


class FaceContract(Contract):
    """No module of `proxops.FOLDER.ROOM` is imported from outside that room."""

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Looks at every import of the graph."""
        past = sorted(
            (importer, imported)
            for imported in graph.modules
            if (room := room_of(imported)) is not None
            for importer in graph.find_modules_that_directly_import(imported)
            if importer != room and not importer.startswith(f"{room}.")
        )
        return ContractCheck(kept=not past, metadata={"past": past})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Prints each import that goes past a face."""
        for importer, imported in check.metadata["past"]:
            output.print_error(f"{importer} imports {imported}: import from {room_of(imported)}")
