#!/bin/sh
# Two short episodes with nothing but curl, one in each protocol: what any language has to do.
#
#     python manage.py create_agent --owner me --name "By hand" --algorithm PPO --action-space 2 \
#         --observation-space '[[4], -10, 10]'
#     SHEPHERD_API_KEY=sk_... sh clients/examples/curl.sh
#
# SHEPHERD_URL says where Shepherd is, if not at http://127.0.0.1:8000. The observations are made up.
set -eu
url=${SHEPHERD_URL:-http://127.0.0.1:8000}
key=${SHEPHERD_API_KEY:?set it to the API key of an agent}

# call METHOD PATH KEY [JSON]: prints the reply; an error is printed too, and ends the script
call() {
    curl --silent --show-error --fail-with-body --request "$1" "${url%/}$2" --header "Authorization: Bearer $3" \
        --header "Content-Type: application/json" ${4:+--data "$4"} && echo
}

# session_key JSON: the session key in a login's reply
session_key() {
    echo "$1" | sed 's/.*"session_key": *"\([^"]*\)".*/\1/'
}

# step OBS REWARD TERMINATED SEQ
step() {
    call POST /api/v1/step "$session" \
        "{\"obs\": $1, \"reward\": $2, \"terminated\": $3, \"truncated\": false, \"seq\": $4}"
}

# old_step OBS REWARD DONE: a step in the original protocol
old_step() {
    call POST /shepherd/env/ "" \
        "{\"session_key\": \"$session\", \"obs\": $1, \"reward\": $2, \"done\": $3, \"info\": {}}"
}

echo "== /api/v1/: log in"
reply=$(call POST /api/v1/sessions "$key") || { echo "$reply"; exit 1; }
session=$(session_key "$reply")

echo "== an episode of two actions; the reward of the first step is ignored, the last one gets no action"
step "[0.01, 0.0, 0.02, 0.0]" 0.0 false 1
step "[0.02, 0.1, 0.01, 0.1]" 1.0 false 2
step "[0.03, 0.2, 0.00, 0.2]" 1.0 true 3

echo "== the last step once more, as after a lost reply: the stored answer"
step "[0.03, 0.2, 0.00, 0.2]" 1.0 true 3

echo "== close"
call DELETE /api/v1/session "$session"

echo "== /shepherd/, the original protocol: log in"
reply=$(call POST /shepherd/login_user/ "" "{\"apikey\": \"$key\"}") || { echo "$reply"; exit 1; }
session=$(session_key "$reply")

echo "== an episode; done means terminated"
old_step "[0.01, 0.0, 0.02, 0.0]" 0.0 false
old_step "[0.02, 0.1, 0.01, 0.1]" 1.0 false
old_step "[0.03, 0.2, 0.00, 0.2]" 1.0 true

echo "== close: no observation"
old_step null 0.0 true
