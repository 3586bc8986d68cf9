"""What a check.json holds of a PI controller, as far as an export reads it."""

DESIGNED = {
    "schema": "deatwin/check/1",
    "operating": {
        "input": 2.0,
        "output": 1.0,
        "static_gain": 1.0,
        "status": "ok",
        "sample_time": 0.02,
        "input_unit": "V",
        "output_unit": "mm",
    },
    "controller": {
        "kind": "linear",
        "name": "PI",
        "sample_time": 0.02,
        "operating_input": 2.0,
        "operating_output": 1.0,
        "command_min": 1.0,
        "command_max": 4.0,
        "closed_loop_time": 0.5,
        "windup": [0.1],
        "law": {"a": [[1.0]], "b": [[0.04, -0.04]], "c": [1.0], "d": [0.5, -0.5]},
    },
}
