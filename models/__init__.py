"""What is shaken and what shakes it: scenes and motions. Knows no engine and no cluster."""
