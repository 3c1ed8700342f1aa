"""An emulated Modbus device with any register map, on TCP or a pseudo-terminal."""
