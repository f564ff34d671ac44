"""tools/check_proto finds what breaks clients, and lets pass what does not."""
import importlib.machinery
import importlib.util
import pathlib
import tempfile
import unittest

LOADER = importlib.machinery.SourceFileLoader('check_proto', str(pathlib.Path(__file__).resolve().parents[1] / 'tools/check_proto'))
SPEC = importlib.util.spec_from_loader('check_proto', LOADER)
check_proto = importlib.util.module_from_spec(SPEC)
LOADER.exec_module(check_proto)

BEFORE = '''syntax = "proto3";
package p.v1;
service S {
  rpc Get(Request) returns (stream Answer);
}
message Request {
  enum Kind {
    KIND_UNSPECIFIED = 0;
    KIND_ONE = 1;
  }
  string name = 1;
  repeated int64 times = 2;
  Kind kind = 3;
  oneof by {
    Answer answer = 4;
    bool all = 5;
  }
  optional double moved = 6;
}
message Answer {}
'''


class CheckProto(unittest.TestCase):
    def lines(self, text):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, 'p/v1/s.proto')
            path.parent.mkdir(parents=True)
            path.write_text(text)
            return set(check_proto.interface(pathlib.Path(folder)))

    def broken(self, old, new):
        self.assertIn(old, BEFORE)
        return sorted(self.lines(BEFORE) - self.lines(BEFORE.replace(old, new)))

    def test_what_there_is(self):
        self.assertEqual(self.lines(BEFORE), {
            'rpc p.v1.S.Get: p.v1.Request -> stream p.v1.Answer', 'message p.v1.Request', 'message p.v1.Answer',
            'enum p.v1.Request.Kind: 0 KIND_UNSPECIFIED', 'enum p.v1.Request.Kind: 1 KIND_ONE',
            'field p.v1.Request: 1 name string', 'field p.v1.Request: 2 times repeated int64',
            'field p.v1.Request: 3 kind p.v1.Request.Kind', 'field p.v1.Request: 4 answer p.v1.Answer in by',
            'field p.v1.Request: 5 all bool in by', 'field p.v1.Request: 6 moved double'})

    def test_adding_breaks_nothing(self):
        for old, new in (('string name = 1;', 'string name = 1; string more = 9;'), ('KIND_ONE = 1;', 'KIND_ONE = 1; KIND_TWO = 2;'),
                         ('message Answer {}', 'message Answer { bool ok = 1; } message Another {}'),
                         ('service S {', 'service S {\n  rpc Put(Request) returns (Answer);')):
            self.assertEqual(self.broken(old, new), [], new)

    def test_changes_do(self):
        for old, new in (('string name = 1;', 'string title = 1;'), ('string name = 1;', 'string name = 7;'),
                         ('string name = 1;', 'bytes name = 1;'), ('string name = 1;', 'repeated string name = 1;'),
                         ('string name = 1;', ''), ('KIND_ONE = 1;', 'KIND_ONE = 2;'), ('KIND_ONE = 1;', 'KIND_FIRST = 1;'),
                         ('(stream Answer)', '(Answer)'), ('rpc Get(Request) returns (stream Answer);', ''), ('    bool all = 5;\n  }', '  }\n  bool all = 5;')):
            self.assertEqual(len(self.broken(old, new)), 1, f'{old} -> {new}')


if __name__ == '__main__':
    unittest.main()
