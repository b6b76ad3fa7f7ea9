"""What was printed, taken apart."""


def cells(text: str) -> list[list[str]]:
    """Cells of each row of the tables in a text, headings apart."""
    return [[cell.strip() for cell in line[1:-1].split("│")] for line in text.splitlines() if line.startswith("│")]
