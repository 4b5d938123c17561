# The two commands of the README. Each makes its own environment in .venv.
PYTHON ?= python3
BIN := .venv/bin
# mypy needs a folder named as the package; the repository may be cloned under any name.
LINK := .venv/src/gyrospark
# Bytecode is written of what is imported, when it is: most of what is installed never is. Workers of
# the tests would each compile the largest packages, which is done beside the check of types.
INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile -e
LARGE := distributed, h5netcdf, matplotlib.pyplot, pandas, scipy.spatial.transform, sympy, xarray, zarr

.PHONY: demo test quick test-long bench lint generated docs clean

demo: .venv/demo
	$(BIN)/gyrospark run fast-top --scheme G-L --stages 3 --rep gamma --gamma m \
	    --dt 1e-3 --steps 2000 --plot demo.png --show demo.html

# What a file derives and makes is made once. Files go in the order of their folders and names, for
# by default files of few tests come last, and the longest are among them. Each core has a worker, up
# to four, for each imports SymPy.
test: .venv/ready
	+$(MAKE) --no-print-directory -j 2 lint quick

# Types take one process half a minute: beside the tests, it costs no waiting.
quick: .venv/bytecode
	$(BIN)/pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

# Whole products, long runs, millions of steps: what "slow" marks.
test-long: .venv/bytecode
	$(BIN)/pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder -m slow

# Speed and accuracy beside other programs: make bench WHAT="events --rounds 3"
bench: .venv/ready
	$(BIN)/python -m benchmarks $(WHAT)

lint: .venv/ready
	$(BIN)/ruff check .
	cd .venv/src && MYPYPATH=. ../bin/mypy --config-file ../../pyproject.toml \
	    -m gyrospark -p benchmarks $(addprefix -p gyrospark.,certificates commands core engine generator interop references runtime storage studies sweeps targets) \
	    $(addprefix -m gyrospark.,__main__ api errors)

# The site, in build/site, with a line for each page that is read; warnings are errors, outputs of
# cells are kept in build/cells.
docs: .venv/docs
	$(BIN)/sphinx-build -W --keep-going --quiet -j auto docs build/site

# Bring the checked-in steppers and the outputs in README up to date.
generated: .venv/ready
	$(BIN)/pytest -q tests/golden/test_generated.py tests/docs/test_readme_outputs.py -k up_to_date --update

# The one is a part of the other, in whatever order they are made.
.venv/demo: pyproject.toml
	$(PYTHON) -m venv .venv
	$(INSTALL) ".[plot]"
	touch $@

.venv/ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(INSTALL) ".[test]"
	mkdir -p .venv/src && ln -sfn ../.. $(LINK) && ln -sfn ../../benchmarks .venv/src/benchmarks
	touch .venv/demo $@

.venv/bytecode: .venv/ready
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -c "import $(LARGE)"
	touch $@

.venv/docs: pyproject.toml
	$(PYTHON) -m venv .venv
	$(INSTALL) ".[docs]"
	touch .venv/demo $@

clean:
	rm -rf .venv build dist *.egg-info demo.png demo.html
