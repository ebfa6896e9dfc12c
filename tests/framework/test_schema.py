import json

from slideframe.commands.schema import config_schema


def references(node):
    if isinstance(node, dict):
        if "$ref" in node:
            yield node["$ref"]
        for child in node.values():
            yield from references(child)
    if isinstance(node, list):
        for child in node:
            yield from references(child)


def test_every_reference_leads_somewhere():
    schema = config_schema()
    found = set(references(schema))
    assert found
    for reference in found:
        assert reference.removeprefix("#/$defs/") in schema["$defs"], reference


def test_every_installed_plugin_has_its_options():
    tables = config_schema()["properties"]["plugins"]["properties"]
    assert tables["gs_torch"]["properties"]["iterations"]["type"] == "integer"
    json.dumps(tables)
