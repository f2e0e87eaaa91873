"""What every node needs: initialisation, time, connections, and messages from and to values."""
