"""Routes in simulation: ways through the storey, a driver who knows them, and the closed loop."""
