-- For wrk: requests the paths listed in the file $PATHS in a fixed random order; each thread starts elsewhere in the list.
-- Prints the results as one line of JSON.
local threads = 0
function setup(thread)
   thread:set("number", threads)
   threads = threads + 1
end

function init()
   local paths = {}
   for path in io.lines(os.getenv("PATHS")) do paths[#paths + 1] = path end
   math.randomseed(7)
   for i = #paths, 2, -1 do
      local j = math.random(i)
      paths[i], paths[j] = paths[j], paths[i]
   end
   requests = {}
   for i, path in ipairs(paths) do requests[i] = wrk.format("GET", path) end
   at = number * 7919 % #requests
end

function request()
   at = at % #requests + 1
   return requests[at]
end

function done(summary, latency)
   local e = summary.errors
   io.write(string.format(
      '\nJSON {"requests":%d,"seconds":%.3f,"bytes":%d,"p50_us":%d,"p99_us":%d,"max_us":%d,"errors":%d}\n',
      summary.requests, summary.duration / 1e6, summary.bytes, latency:percentile(50), latency:percentile(99),
      latency.max, e.connect + e.read + e.write + e.status + e.timeout))
end
