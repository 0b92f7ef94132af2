# make demo   a data set of synthetic faces and a contact sheet, in ./demo
# make test   lint, format, types and tests
# Both set up .venv first (Debian packages included) and are quick when nothing is left to set up.
.PHONY: demo test check golden bench clean

VENV := .venv/bin

demo:
	@scripts/setup.sh demo
	@$(VENV)/glsim demo -o demo

test: check
	@GLSIM_EXPECT_RENDERER=$(GLSIM_EXPECT_RENDERER) $(VENV)/python -m pytest

check:
	@scripts/setup.sh test
	@$(VENV)/ruff check .
	@$(VENV)/ruff format --check .
	@$(VENV)/mypy

bench:
	@scripts/setup.sh test
	@$(VENV)/python -m benchmarks.generate

clean:
	rm -rf .venv demo
