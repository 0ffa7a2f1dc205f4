"""The estimate for a Jetson rests on the loops of the kernel as it is compiled for it."""

import shutil

import pytest

from benchmarks.latency import orin_nano
from benchmarks.latency.cases import Case
from edge_runtime.errors import ConfigError

KERNEL = """
observe_baseline:
.L1:
	fmla	v0.4s, v1.4s, v2.4s
	bne	.L1
	.size	observe_baseline, .-observe_baseline
product_baseline:
.L2:
	ldr	q1, [x0]
	.loc 1 2 3
	fmla	v0.4s, v1.4s, v2.s[0]
	fmla	v3.4s, v1.4s, v2.s[0]
	fmla	v4.4s, v1.4s, v2.s[0]
	fmla	v5.4s, v1.4s, v2.s[0]
	bne	.L2
.L3:
	cbz	x1, .L2
	ret
	.size	product_baseline, .-product_baseline
"""

needs_compiler = pytest.mark.skipif(
    shutil.which("aarch64-linux-gnu-gcc") is None, reason="no compiler for aarch64"
)


def test_loops_are_found_by_their_jumps_back():
    (loop,) = orin_nano.inner_loops(KERNEL)
    assert loop[0] == "\tldr\tq1, [x0]"
    assert len(loop) == 6
    assert orin_nano.inner_loop(KERNEL, 1) == loop
    with pytest.raises(ConfigError, match="no loop over 3 rows"):
        orin_nano.inner_loop(KERNEL, 3)


def test_the_arithmetic_grows_with_the_inputs(monkeypatch, tmp_path):
    analyser = tmp_path / "llvm-mca"
    analyser.write_text(
        "#!/bin/sh\n[ $1 = --version ] && echo LLVM version 19.1 || echo 'Total Cycles:      2000'\n"
    )
    analyser.chmod(0o755)
    monkeypatch.setattr(orin_nano, "assembly", lambda: KERNEL)
    monkeypatch.setenv("PATH", str(tmp_path))
    case = Case(layers=(32, 40), steps=3, action_dim=0)
    found = orin_nano.estimate(case)
    assert found.cycles == 2.0
    assert found.arithmetic_us == pytest.approx(3 * 32 * 3 * 2.0 / 1.5e3)
    analyser.write_text("#!/bin/sh\necho LLVM version 14.0\n")
    with pytest.raises(ConfigError, match="llvm-19"):
        orin_nano.estimate(case)


@needs_compiler
def test_the_kernel_keeps_no_sums_on_the_stack_of_the_robots_processor():
    loops = list(orin_nano.inner_loops(orin_nano.assembly()))
    assert len(loops) >= 5
    assert not [line for loop in loops for line in loop if "[sp" in line]
    assert [orin_nano.inner_loop(orin_nano.assembly(), rows) for rows in (3, 4, 5)]
