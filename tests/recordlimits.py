"""What a diagnosis tells of a record beside its causes: left out, left over, not testable."""


def place(domain: str, second: str | None = None) -> dict[str, object]:
    """Return a place without a name."""
    return {
        "domain": domain,
        "second_domain": second,
        "location": -124.691,
        "extent": [-127.762, -60.8156],
        "unit": "rad/s",
        "size_nm": 0.1234,
        "share_of_variance": 0.04,
    }


LIMITS = {
    "left_out": [
        {"reason": "the acceleration is not resolved", "samples": 19000, "share": 19000 / 24841},
        {"reason": "spikes", "samples": 289, "share": 289 / 24841},
    ],
    "rest": {"heldout_rms_nm": 0.119, "noise_rms_nm": 0.043, "told": [place("velocity")]},
    "testable": [
        {"name": name, "testable": not because, "because": because}
        for name, because in (
            ("spikes", ""),
            ("zero-step", ""),
            ("mains-hum", "torque low-passed at 10 Hz; nine tenths of it would stand above 50 Hz"),
            ("tooth-mesh", "torque low-passed at 10 Hz; nine tenths of it would stand above 1 kHz"),
            ("side-force", "the record has no load_torque_nm; needed: a known load"),
            ("backlash", "the record has no load_torque_nm; needed: a known load"),
            ("creep", "the record has no load_torque_nm; needed: a known load"),
            ("crosstalk", "the record has no motor_current_a; needed: the motor current, A"),
        )
    ],
}
