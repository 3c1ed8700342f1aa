from hdbench.records import FloatArray

def run(
    order: FloatArray,
    process_noise: FloatArray,
    misalignment: FloatArray,
    parameters: FloatArray,
    state: FloatArray,
    time_s: FloatArray,
    velocity_rad_s: FloatArray,
    torque_nm: FloatArray,
    angle_rad: FloatArray | None,
    torque_expected_nm: FloatArray,
    ripple_nm: FloatArray,
    misalignment_nm: FloatArray,
    torque_filtered_nm: FloatArray,
    /,
) -> int: ...
