"""Text from others, as a terminal may show it."""


def printable(text: str) -> str:
    """Replace what a terminal might take for a command, or for the end of the line."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
