"""Sphinx extension: the cells of a page run in a fork of the process that reads it.

A Jupyter kernel imports SymPy, matplotlib and itself again for each page, some 2.5 s of CPU time. A
fork has them, with what SymPy and Jinja keep of a first derivation. The cells run in IPython's
shell: outputs are as in a notebook. Only Linux forks safely after such imports; other systems start
a kernel for each page.
"""

from __future__ import annotations

import base64
import json
import logging
import os
import signal
import sys
import tempfile
import time
import traceback
from typing import Any

from sphinx.application import Sphinx

__all__ = ["run_cells"]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the handler to Sphinx's event."""
    app.connect("builder-inited", prepare_forks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def prepare_forks(app: Sphinx) -> None:
    """Make a first run, by which packages are imported, and let myst_nb run cells in forks."""
    if sys.platform != "linux" or "myst_nb" not in app.extensions:
        return
    import matplotlib.pyplot  # noqa: F401
    import matplotlib_inline.backend_inline  # noqa: F401
    import myst_nb.core.execute.cache as execution
    from jupyter_cache.cache.main import JupyterCacheBase

    import gyrospark as gs

    model = gs.models.double_top()  # of the first page, which reads its stepper from the cache
    run = gs.stepper("G-L", stages=3, system=model).integrate(model, dt=1e-3, steps=2)
    with tempfile.TemporaryDirectory() as folder:
        run.show(f"{folder}/picture.png")
    run.plot()
    # Beyond 1,000 pages old ones are deleted; a page that another process is writing may count as
    # one of them. There are never so many.
    JupyterCacheBase.truncate_caches = lambda cache: None
    execution.single_nb_execution = run_cells  # where a notebook with a kernel would be executed


def run_cells(notebook: Any, cwd: str, *, timeout: int, **options: Any) -> Any:
    """Run the cells of a notebook in a fork, and add their outputs to them.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
    cwd : str
        The folder in which the cells run.
    timeout : int
        Seconds after which the fork is ended by a signal.

    Returns
    -------
    jupyter_cache.executors.utils.ExecutionResult
        With the exception of the first cell that failed, or None.
    """
    from jupyter_cache.executors.utils import ExecutionResult
    from nbformat import NotebookNode, from_dict

    began = time.monotonic()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    with tempfile.TemporaryFile("w+", encoding="utf-8") as file:
        number = os.fork()
        if number == 0:
            status = 1
            try:
                signal.alarm(timeout)
                os.chdir(cwd)
                logging.getLogger().handlers.clear()  # a package of the theme logs all levels
                json.dump(_outputs([cell.source for cell in cells]), file)
                file.flush()
                status = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
        file.seek(0)
        outputs, failure = json.load(file) if status == 0 else (
            [], f"the process of the cells ended with status {status}")
    for count, (cell, of_cell) in enumerate(zip(cells, outputs, strict=False), start=1):
        cell.execution_count = count
        cell.outputs = [from_dict(output) for output in of_cell]
    notebook.metadata.setdefault("language_info", NotebookNode(name="python"))
    return ExecutionResult(notebook, cwd, time.monotonic() - began,
                           RuntimeError(failure) if failure else None, failure or None)


def _outputs(sources: list[str]) -> tuple[list[list[dict[str, Any]]], str]:
    """Return the outputs of each cell, and the traceback of a failure, after which none runs."""
    from IPython.core.displayhook import DisplayHook
    from IPython.core.displaypub import DisplayPublisher
    from IPython.core.interactiveshell import InteractiveShell
    from traitlets import Type
    from traitlets.config import Config

    listed: list[list[dict[str, Any]]] = []

    def show(kind: str, data: dict[str, Any], metadata: dict[str, Any], **more: Any) -> None:
        data = {mime: base64.b64encode(content).decode() if isinstance(content, bytes) else content
                for mime, content in data.items()}
        listed[-1].append({"output_type": kind, "data": data, "metadata": metadata, **more})

    class Publisher(DisplayPublisher):
        def publish(self, data: Any, metadata: Any = None, *, update: bool = False,
                    **_: Any) -> None:
            if update:
                raise NotImplementedError("cells of the site cannot change an earlier output")
            show("display_data", data, metadata or {})

    class Hook(DisplayHook):
        def write_output_prompt(self) -> None: ...

        def write_format_data(self, format_dict: Any, md_dict: Any = None) -> None:
            show("execute_result", format_dict, md_dict or {}, execution_count=len(listed))

        def finish_displayhook(self) -> None: ...

    class Shell(InteractiveShell):
        displayhook_class = Type(Hook)
        display_pub_class = Type(Publisher)

        def enable_gui(self, gui: Any = None) -> None: ...

    class Stream:
        encoding = "utf-8"

        def __init__(self, name: str) -> None:
            self.name = name

        def write(self, text: str) -> int:
            last = listed[-1][-1] if listed and listed[-1] else {}
            if last.get("name") == self.name:
                last["text"] += text
            elif listed:
                listed[-1].append({"output_type": "stream", "name": self.name, "text": text})
            return len(text)

        def flush(self) -> None: ...

        def isatty(self) -> bool:
            return False

    sys.path.insert(0, "")
    shell = Shell.instance(config=Config(HistoryManager={"enabled": False}))
    shell.enable_matplotlib("inline")
    sys.stdout, sys.stderr = Stream("stdout"), Stream("stderr")  # type: ignore[assignment]
    for source in sources:
        listed.append([])
        result = shell.run_cell(source, store_history=True)
        error = result.error_before_exec or result.error_in_exec
        if error is not None:
            return listed, "".join(traceback.format_exception(error))
    return listed, ""
