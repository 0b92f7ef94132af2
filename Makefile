# make demo   a data set of synthetic faces and a contact sheet, in ./demo
# make test   lint, format, types and tests
# Both set up .venv first (Debian packages included) and are quick when nothing is left to set up.
.PHONY: demo test check golden bench clean

VENV := .venv/bin

demo:
	@scripts/setup.sh demo
	@$(VENV)/glsim generate -o demo/data --subjects 12 --frames-per-subject 30 --crop 160 \
	    --layers clean,noisy,infrared,reason --set pose.yaw_deg='{ uniform = [-25, 25], per = "sequence" }'
	@$(VENV)/glsim preview demo/data -o demo --frames 8

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
