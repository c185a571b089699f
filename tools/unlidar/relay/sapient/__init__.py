"""SAPIENT (BSI Flex 335 v2): a station as a node of a counter-drone system."""
