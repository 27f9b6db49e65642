"""Routes in simulation: ways through the storey, their driver, and the closed loop."""
