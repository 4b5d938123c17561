"""Parsing: the grammar of arithmetic, its exact numbers, files of unknown origin.

Text is read character by character in bounded time and memory, and is never handed to Python or to
SymPy's parsers.

    tokens             the words of a text, and error messages that point to a place in it
    grammar            one parser for whatever numbers compute
    bounded_numbers    exact numbers whose every operation is bounded
    exact_expressions  arithmetic text as an exact number, such as an entry of a tableau
    reserved_names     names that C keeps for itself
    text_file          a file as text, or an error
"""
