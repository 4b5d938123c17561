"""Steppers as WebAssembly, and as pages that integrate while they are looked at.

In: manifest and sources of a stepper.
Out: a WebAssembly module, or one page of HTML.
Open first: ``webassembly``.

    webassembly     the target wasm: a module, and its functions in JavaScript
    page            the target web, ``gs.playground``

``glue.c`` is compiled with each stepper, ``stepper.js`` calls it; ``page.html``, ``page.css`` and
``page.js`` are the page, which ``scene.js`` of ``runtime/plotting/`` draws.
"""
