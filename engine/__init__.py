"""The engine: a library of C headers in ``gyrospark/``, and how its includes are resolved."""
