"""Driver for a bench controller node on Modbus TCP (`docs/node-protocol.md`)."""
