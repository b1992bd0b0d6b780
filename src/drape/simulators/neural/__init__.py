"""Neural simulators: networks that predict how cloth accelerates within a step."""
