#!/usr/bin/env python3
"""Checks that every #include between modules follows the arrows of docs/architecture.md: strictly one way.

usage: check_includes.py ROOT"""
import pathlib
import re
import sys

# module: the modules whose headers it may include directly; a module that one of them may include is allowed, too.
ALLOWED = {
    'base': [],
    'geometry': ['base'],
    'image': ['geometry'],
    'optimization': ['geometry'],
    'map': ['image'],
    'place': ['image'],
    'direct': ['image', 'optimization'],
    'tracking': ['map', 'place', 'optimization'],
    'mapping': ['tracking', 'direct'],
    'store': ['map', 'place'],
    'health': ['store', 'place'],
    'io': ['map'],
    'api': ['map'],
    'engine': ['api', 'direct', 'mapping', 'health', 'store'],
    'cairn': [],  # the public headers
    'wire': ['api', 'store'],
    'client': ['api', 'direct', 'tracking', 'health', 'store', 'wire', 'cairn'],
    'host': ['engine', 'client', 'io', 'care'],
    'server': ['host', 'wire', 'io'],
    'synth': ['health', 'io'],
    'eval': ['io'],
    'plot': ['io', 'text'],
    'text': ['base'],
    'inspect': ['tracking', 'store'],
    'exchange': ['io', 'inspect'],
    'care': ['engine', 'exchange'],
    'cli': ['care', 'client', 'engine', 'health', 'host', 'inspect', 'exchange', 'io', 'synth', 'eval', 'plot', 'text'],
}
# Headers of a module that another may include although the module as a whole is closed to it.
ONLY_HEADERS = {('mapping', 'direct'): {'direct/packet.h'}}
FOLDERS = {**{name: f'src/{name}' for name in ALLOWED}, 'cairn': 'client/include', 'client': 'client', 'server': 'server', 'synth': 'tools/synth', 'eval': 'tools/eval',
           'plot': 'tools/plot', 'text': 'tools/text', 'cli': 'tools/cli'}
INCLUDE = re.compile(r'^\s*#include\s+"([a-z_]+)/')
# What public headers may include: each other, the standard library, Abseil's Status; conversions.h also what it converts.
PUBLIC_INCLUDE = re.compile(r'^\s*#\s*include\s+("cairn/[a-z_]+\.h"|<[a-z_]+(\.h)?>|<absl/status/status(or)?\.h>)')
CONVERTED = re.compile(r'^\s*#\s*include\s+<(Eigen/(Core|Geometry)|opencv2/core\.hpp)>')


def reachable(module):
    found, waiting = {module}, [module]
    while waiting:
        for other in ALLOWED[waiting.pop()]:
            if other not in found:
                found.add(other)
                waiting.append(other)
    return found


def public_header_errors(root):
    errors, folder = [], root / 'client/include'
    for path in sorted(folder.rglob('*.h')):
        for number, line in enumerate(path.read_text().splitlines(), 1):
            if not re.match(r'^\s*#\s*include', line) or PUBLIC_INCLUDE.match(line):
                continue
            if path.name != 'conversions.h' or not CONVERTED.match(line):
                errors.append(f'{path.relative_to(root)}:{number}: not in a public header: {line.strip()}')
    return errors


def main():
    root = pathlib.Path(sys.argv[1])
    errors, checked = public_header_errors(root), 0
    for module, folder in FOLDERS.items():
        allowed = reachable(module)
        for path in sorted([*root.joinpath(folder).rglob('*.h'), *root.joinpath(folder).rglob('*.cc')]):
            is_test = path.stem.endswith('_test')
            for number, line in enumerate(path.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                if not match or match[1] not in ALLOWED:
                    continue
                checked += 1
                header = line.split('"')[1]
                restricted = ONLY_HEADERS.get((module, match[1]))
                if match[1] not in allowed or (restricted and header not in restricted and not is_test):
                    errors.append(f'{path.relative_to(root)}:{number}: {module} must not include {header}')
    print('\n'.join(errors) or f'{checked} includes between modules, all in the allowed direction')
    if not checked:
        sys.exit('no include found: wrong root?')
    sys.exit(1 if errors else 0)


if __name__ == '__main__':
    main()
