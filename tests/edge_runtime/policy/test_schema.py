"""Every refusal of a manifest names the file, the key, what was found and what fits."""

import pytest
from bundle_files import edit_manifest, sign, write_bundle

from edge_runtime.errors import BundleError
from edge_runtime.policy.bundle import load_bundle

KNOWN = "allowed: 'position', 'velocity', 'heading', 'yaw_rate', 'previous_action', 'goal_offset'"
POSITIVE = "must be between 1e-06 and 1e+06"

REFUSALS = [
    ("format", "cfpg-bundle/3", "format is 'cfpg-bundle/3', must be 'cfpg-bundle/1' or 'cfpg-bundle/2'"),
    ("format", None, "format is None, must be"),
    ("name", " ", "name is ' ', must be a name of up to 200 printable characters"),
    ("runtime", "torch", "runtime: Invalid enum value 'torch'; allowed: 'numpy', 'onnxruntime'"),
    ("control_rate_hz", 0, "control_rate_hz is 0.0, must be between 1 and 1000"),
    ("control_rate_hz", 1e9, "control_rate_hz is 1000000000.0, must be between 1 and 1000"),
    ("control_rate_hz", "10", "control_rate_hz: Expected `float`, got `str`"),
    ("euler_steps", 0, "euler_steps is 0, must be between 1 and 1000"),
    ("sampler_steps", 0, "sampler_steps is 0, must be between 1 and 1000"),
    ("sampler_steps", 10**9, "sampler_steps is 1000000000, must be between 1 and 1000"),
    ("sampler", "heun", "sampler: Invalid enum value 'heun'; allowed: 'euler', 'exponential'"),
    ("euler_steps", True, "euler_steps: Expected `int`, got `bool`"),
    ("body.radius_m", -0.1, f"body.radius_m is -0.1, {POSITIVE}"),
    ("body.lidar_rays", -1, "body.lidar_rays is -1, must be between 0 and 1024"),
    ("body.lidar_range_m", 0, f"body.lidar_range_m is 0.0, {POSITIVE}"),
    ("motion.mass_kg", 0, f"motion.mass_kg is 0.0, {POSITIVE}"),
    ("motion.drag", 1.0, "motion.drag is 1.0, must be at least 0 and below 1"),
    ("motion.dt_s", -1, f"motion.dt_s is -1.0, {POSITIVE}"),
    ("motion.dt_s", 0.2, "motion.dt_s is 0.2, must be 1 / control_rate_hz"),
    ("motion.substeps", 0, "motion.substeps is 0, must be between 1 and 100"),
    ("observation", [], "observation is []"),
    ("observation.0.source", "pose", f"observation[0].source: Invalid value 'pose'; {KNOWN}"),
    ("observation.0.source", 3, "observation[0].source: Expected `str`, got `int`"),
    ("observation.0", {"name": "position"}, f"observation[0].source: missing; {KNOWN}"),
    ("observation.0", "position", "observation[0]: Expected `table`, got `str`"),
    ("observation.0.name", " ", "observation[0].name is ' ', must be a name of up to 200 printable"),
    (
        "observation.2.axes",
        "body",
        "observation[2].axes: unknown key; allowed: name, size, unit, seen",
    ),
    ("observation.2.frame", "own", "observation[2].frame: Invalid enum value 'own'; allowed: 'team', 'body'"),
    (
        "observation.1.name",
        "position",
        "observation[1].name is 'position', must be named once, it is repeated",
    ),
    ("observation.1.unit", "km/h", "observation[1].unit is 'km/h', must be 'm/s' for velocity"),
    ("observation.0.size", 3, "observation[0].size is 3, must be 2 for position"),
    ("observation.3.size", 11, "observation[3].size is 11, must be 12 for proximity"),
    ("action", [], "action: number of components is 0, must be between 1 and 8"),
    ("action.0.name", "force_y", "action[0].name is 'force_y', must be named once, it is repeated"),
    ("action.1.unit", "", "action[1].unit is '', must be a name of up to 200 printable characters"),
    (
        "motion.type",
        "hover",
        "motion.type: Invalid value 'hover'; allowed: 'point_force', 'point_acc",
    ),
    ("motion.dims", 3, "action: number of components is 2, must be 3 for point_force"),
    ("motion.drag_n", 1, "motion.drag_n: unknown key; allowed: mass_kg, drag"),
    ("action.1.low", 1.0, "action[1].low is 1.0, must be below its high, 1.0"),
    ("network", None, "network is None, must be given for runtime 'numpy'"),
    ("network.activation", "relu", "network.activation: Invalid enum value 'relu'; allowed: "),
    ("name", "n" * 201, "must be a name of up to 200 printable characters"),
    ("name", "nav\x1b[2J", r"name is 'nav\x1b[2J', must be a name of up to 200 printable characters"),
    ("training.commit", "a\nb", r"training.commit is 'a\nb', must be a name of up to 200 printable"),
    ("body.lidar_rays", 1_000_000, "body.lidar_rays is 1000000, must be between 0 and 1024"),
    ("network.hidden", [], "network.hidden: number of layers is 0, must be between 1 and 16"),
    ("network.hidden", [1] * 100_000, "network.hidden: number of layers is 100000, must be between 1 and 16"),
    ("network.hidden", [8, 0], "network.hidden[1] is 0, must be between 1 and 4096"),
    ("network.hidden", [2**70], f"network.hidden[0] is {2**70}, must be between 1 and 4096"),
    (
        "network.hidden",
        [4096] * 2,
        "network.hidden: number of weights is 16850944, must be between 1 and 4e+06",
    ),
    ("network.prior_std", 1e155, f"network.prior_std is 1e+155, {POSITIVE}"),
    ("action.0.low", -1e308, "action[0].low is -1e+308, must be between -1e+06 and 1e+06"),
    ("action.0.high", -0.5, "action[0].high is -0.5, must be at least 0, which is rest"),
    ("action.1.low", 0.5, "action[1].low is 0.5, must be at most 0, which is rest"),
    ("network.prior_std", 0, f"network.prior_std is 0.0, {POSITIVE}"),
    ("training.frames", -1, "training.frames is -1, must be at least 0"),
    ("training.score", 1.5, "training.score is 1.5, must be between 0 and 1"),
    ("files", {}, "files is [], must be policy.onnx, policy.npz for 'numpy'"),
    ("files", {"../policy.onnx": "0" * 64}, "files is ['../policy.onnx'], must be policy.onnx, policy.npz"),
    ("files", {"policy.onnx": "0" * 64, "policy.npz": "0"}, "files.policy.npz is '0', must be a SHA-256"),
]


@pytest.mark.parametrize(("key", "value", "complaint"), REFUSALS)
def test_refusal(tmp_path, key, value, complaint):
    directory = write_bundle(tmp_path / "tiny")
    edit_manifest(directory, key, value)
    with pytest.raises(BundleError) as caught:
        load_bundle(directory)
    assert str(caught.value).startswith(f"{directory / 'manifest.json'}: ")
    assert complaint in str(caught.value)


NUMBERS = [
    "control_rate_hz",
    "body.radius_m",
    "body.lidar_range_m",
    "motion.mass_kg",
    "motion.drag",
    "motion.dt_s",
    "action.0.low",
    "action.1.high",
    "network.prior_std",
    "training.score",
]


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
def test_no_number_may_be_infinite_or_nan(tmp_path, key, literal):
    directory = write_bundle(tmp_path / "tiny")
    edit_manifest(directory, key, float(literal))
    if "e999" in literal:  # a number that JSON allows and no float holds
        manifest = (directory / "manifest.json").read_text()
        name = "-Infinity" if literal.startswith("-") else "Infinity"
        sign(directory, manifest.replace(name, literal).encode())
    with pytest.raises(BundleError, match=r"manifest\.json: "):
        load_bundle(directory)
