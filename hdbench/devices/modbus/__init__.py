"""Any polled Modbus device, described by its registers in the profile."""
