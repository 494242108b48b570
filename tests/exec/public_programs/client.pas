{ A client in Pascal: prints what comes, sends "ping" once. }
program client;
uses serial;
var
  port: TSerialHandle;
  bytes: array[0..99] of char;
  len, i, turn: longint;
  line: string;
begin
  port := SerOpen(ParamStr(1));
  SerSetParams(port, 9600, 8, NoneParity, 1, []);
  line := 'ping'#13#10;
  SerWrite(port, line[1], Length(line));
  for turn := 1 to 60 do
  begin
    len := SerReadTimeout(port, bytes, 200);
    for i := 0 to len - 1 do Write(bytes[i]);
  end;
  SerClose(port);
end.
