// Empty: main() is in port_uno.c. Open this folder under the name "famrig" in the Arduino IDE.
