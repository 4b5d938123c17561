"""Parsing: the grammar of arithmetic text, exact numbers, files of unknown origin.

In: text of unknown origin.
Out: expressions and exact numbers, in bounded time and memory.
Open first: ``grammar.parse``.

Text is parsed in bounded time and memory, and is never passed to Python's or SymPy's parsers.

    tokens             tokens of a text, and errors with a position in it
    grammar            one parser for all kinds of values
    bounded_numbers    exact numbers with bounded operations
    exact_expressions  arithmetic text as an exact number, such as an entry of a tableau
    reserved_names     keywords and macros of C
    text_file          the text of a file, or an error
"""
