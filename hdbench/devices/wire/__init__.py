"""One strict Modbus client for all drivers: TCP, TLS and serial lines."""
