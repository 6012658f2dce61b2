"""The allowed values of an option, in a few words."""

from typing import Any


def describe_values(rule: dict[str, Any]) -> str:
    """The values that a JSON Schema property allows, in a few words."""
    if "anyOf" in rule:
        return " or ".join(describe_values(part) for part in rule["anyOf"])
    if "enum" in rule or "const" in rule:
        return ", ".join(str(value) for value in rule.get("enum", [rule.get("const")]))
    if "prefixItems" in rule:
        return f"{len(rule['prefixItems'])} x {describe_values(rule['prefixItems'][0])}"
    if "items" in rule:
        return f"list of {describe_values(rule['items'])}"
    if rule.get("type") == "null":
        return "none"
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    limits = ", ".join(f"{sign} {rule[key]}" for key, sign in signs.items() if key in rule)
    return f"{rule.get('type', 'any')} {limits}".rstrip()
