"""What Redis does in one go, in Lua. Each is small enough to be sent whole each time: none is lost with a restart."""

from __future__ import annotations

from typing import Any

from envs_app.transports.redis.keys import KNOWN, LEASE, SETTLE, SETTLING, ms

NOW = "local t = redis.call('TIME') local now = t[1] * 1000 + math.floor(t[2] / 1000) "

# Somebody lives. If nobody was known to live, Redis has lost its memory: nobody may claim anything until all have spoken.
_SETTLE = f"""
if redis.call('EXISTS', '{KNOWN}') == 0 then redis.call('SET', '{SETTLING}', '1', 'PX', {ms(SETTLE)}) end
redis.call('SET', '{KNOWN}', '1', 'PX', {ms(LEASE)})
"""

# If the execution is gone, the caller is told by the very list that it waits on: this, or that nobody can know yet.
_TELL_IF_GONE = f"""
local function tell(word) redis.call('RPUSH', KEYS[1], word) redis.call('PEXPIRE', KEYS[1], ARGV[3]) return 0 end
if redis.call('EXISTS', KEYS[2]) == 0 then
  local settled = redis.call('EXISTS', '{KNOWN}') == 1 and redis.call('EXISTS', '{SETTLING}') == 0
  return tell(settled and ARGV[1] or ARGV[2])
end
"""

# Whether somebody listens; nobody, where Redis does not say.
_HEARD = """
local function heard(channel) return (redis.pcall('PUBSUB', 'NUMSUB', channel)[2] or 0) > 0 end
"""

# Whether an execution's process is gone though its lease is not: it listened in this run of Redis, and does so no more.
_CUT_OFF = (
    _HEARD
    + """
local function cut_off(lease, channel)
  local run = redis.call('GET', lease)
  if not run or run == '' or heard(channel) then return false end
  local info = redis.pcall('INFO', 'server')
  return type(info) == 'string' and string.find(info, 'run_id:' .. run .. '\\r', 1, true) ~= nil
end
"""
)

# A step for an execution.
SEND = (
    _TELL_IF_GONE
    + """
redis.call('RPUSH', KEYS[4], ARGV[4]) redis.call('PEXPIRE', KEYS[4], ARGV[3])
redis.call('SADD', KEYS[3], KEYS[1]) redis.call('PEXPIRE', KEYS[3], ARGV[3])
return 1
"""
)

# Whether an answer may yet come: Redis may have forgotten the step with all else.
LOOK = (
    _TELL_IF_GONE
    + _CUT_OFF
    + """
if cut_off(KEYS[2], KEYS[4]) then return tell(ARGV[4]) end
if redis.call('SISMEMBER', KEYS[3], KEYS[1]) == 1 then return redis.call('PEXPIRE', KEYS[3], ARGV[3]) end
return redis.call('EXISTS', KEYS[1]) == 1 or tell(ARGV[2])
"""
)

# Keeps the state of a session, unless a newer owner has it.
_KEEP = """
local kept = redis.call('HMGET', KEYS[1], 'generation', 'owner')
local old = tonumber(kept[1] or 0)
local mine = old < tonumber(ARGV[2]) or (old == tonumber(ARGV[2]) and kept[2] == ARGV[1])
if mine then
  redis.call('HSET', KEYS[1], 'owner', ARGV[1], 'generation', ARGV[2], 'state', ARGV[3])
  redis.call('PEXPIRE', KEYS[1], ARGV[4])
end
"""
KEEP = _KEEP + "return mine and 1 or 0"

# An answer, with the state of its session: both or neither. Who has lost the session to a newer owner answers nothing.
ANSWER = (
    _KEEP
    + """
redis.call('RPUSH', KEYS[2], mine and ARGV[5] or ARGV[6]) redis.call('PEXPIRE', KEYS[2], ARGV[7])
redis.call('SREM', KEYS[3], KEYS[2])
return mine and 1 or 0
"""
)

# The executions of an agent that were killed. Names of keys: without the uid.
CUT_OFF = (
    _CUT_OFF
    + """
local found = {}
for _, uid in ipairs(redis.call('HKEYS', KEYS[1])) do
  if cut_off(KEYS[2] .. uid, KEYS[3] .. uid) then table.insert(found, uid) end
end
return found
"""
)

# A sign of life. Returns whether the last one was still known, and whether the execution is listened for. One that saves has no
# lease any more: it serves nobody.
BEAT = (
    NOW
    + _SETTLE
    + _HEARD
    + """
local known = redis.call('EXISTS', KEYS[1])
local listens = heard(KEYS[7])
if ARGV[6] == '1' then redis.call('SET', KEYS[1], listens and ARGV[9] or '', 'PX', ARGV[3]) end
redis.call('HSET', KEYS[2], ARGV[1], now .. ':' .. ARGV[2]) redis.call('PEXPIRE', KEYS[2], ARGV[4])
redis.call('ZADD', KEYS[3], now, ARGV[5]) redis.call('PEXPIRE', KEYS[3], ARGV[4])
redis.call('ZADD', KEYS[4], now + ARGV[3], ARGV[1]) redis.call('PEXPIRE', KEYS[4], ARGV[4])
if ARGV[8] ~= '' then
  redis.call('HSET', KEYS[5], ARGV[7], now .. ':' .. ARGV[8]) redis.call('PEXPIRE', KEYS[5], ARGV[4])
  redis.call('PEXPIRE', KEYS[6], ARGV[4])
end
return {known, listens and 1 or 0}
"""
)

# An execution will be launched.
ANNOUNCE = (
    NOW
    + """
redis.call('SET', KEYS[1], '', 'PX', ARGV[3])
redis.call('ZREMRANGEBYSCORE', KEYS[2], '-inf', now)
redis.call('ZADD', KEYS[2], now + ARGV[3], ARGV[1]) redis.call('PEXPIRE', KEYS[2], ARGV[4])
redis.call('ZADD', KEYS[3], now, ARGV[2]) redis.call('PEXPIRE', KEYS[3], ARGV[4])
return 1
"""
)

# A machine's sign of life.
BEAT_MACHINE = (
    NOW
    + _SETTLE
    + """
redis.call('HSET', KEYS[1], ARGV[1], now .. ':' .. ARGV[2]) redis.call('PEXPIRE', KEYS[1], ARGV[3])
return 1
"""
)

# Compare-and-set of what is shared of an agent; what executions shall know of it is sent with it.
COMMIT = """
if (redis.call('GET', KEYS[1]) or '') ~= ARGV[1] then return 0 end
redis.call('SET', KEYS[1], ARGV[2], 'PX', ARGV[3])
for i = 2, #KEYS do
  redis.call('RPUSH', KEYS[i], ARGV[i + 3]) redis.call('PEXPIRE', KEYS[i], ARGV[4])
end
return 1
"""

# An execution serves nobody any more: whoever waits for it is told. At its end, nothing of it is left.
BURY = """
for _, waiting in ipairs(redis.call('SMEMBERS', KEYS[1])) do
  redis.call('RPUSH', waiting, ARGV[1]) redis.call('PEXPIRE', waiting, ARGV[2])
end
redis.call('DEL', KEYS[1], KEYS[2], KEYS[3], KEYS[4])
redis.call('ZREM', KEYS[5], ARGV[3])
return ARGV[4] == '1' and redis.call('HDEL', KEYS[6], ARGV[3]) or 0
"""

# Whether it is known who lives.
SETTLED = f"""
if redis.call('EXISTS', '{KNOWN}') == 0 then {_SETTLE} end
return 1 - redis.call('EXISTS', '{SETTLING}')
"""

# Something happened. The number is the time in microseconds, and grows.
EVENT = """
local t = redis.call('TIME')
local number = t[1] * 1000000 + t[2]
local last = redis.call('XREVRANGE', KEYS[1], '+', '-', 'COUNT', 1)[1]
if last then number = math.max(number, tonumber(string.match(last[1], '%d+')) + 1) end
redis.call('XADD', KEYS[1], 'MAXLEN', '~', 10000, string.format('%d-0', number), 'event', ARGV[1])
redis.call('PEXPIRE', KEYS[1], ARGV[2])
return 1
"""


def script(text: str, keys: list[str], *arguments: Any) -> tuple[Any, ...]:
    """The command that runs a script."""
    return ("EVAL", text, len(keys), *keys, *arguments)
