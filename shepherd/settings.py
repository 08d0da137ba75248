"""Settings of Shepherd, from environment variables only; with none set, a clean checkout runs (docs/operations.md)."""

from datetime import timedelta
from pathlib import Path
from typing import Any

from envs_app.logs import logging_config
from shepherd import env
from shepherd.csp import STRICT
from shepherd.theme import UNFOLD as UNFOLD  # the look of the admin

BASE_DIR = Path(__file__).resolve().parent.parent
DATA_DIR = Path(env.text("SHEPHERD_DATA") or BASE_DIR / "var").resolve()

SECRET_KEY = env.secret("SHEPHERD_SECRET_KEY", DATA_DIR / "secrets")
SECRET_KEY_FALLBACKS = env.words("SHEPHERD_OLD_SECRET_KEYS")
DEBUG = env.boolean("SHEPHERD_DEBUG", False)
ALLOWED_HOSTS = [*env.words("SHEPHERD_ALLOWED_HOSTS", "*"), "localhost", "127.0.0.1", "[::1]"]  # health checks
CSRF_TRUSTED_ORIGINS = env.words("SHEPHERD_TRUSTED_ORIGINS")
BEHIND_TLS = env.boolean("SHEPHERD_TLS", False)

INSTALLED_APPS = [
    "unfold",
    "django.contrib.admin",
    "django.contrib.auth",
    "django.contrib.contenttypes",
    "django.contrib.sessions",
    "django.contrib.messages",
    "django.contrib.staticfiles",
    "axes",
    "corsheaders",
    "csp",
    "rest_framework",
    "drf_spectacular",
    "drf_spectacular_sidecar",
    "agents_app",
    "envs_app",
    "frontend",
]
MIDDLEWARE = [
    "django.middleware.security.SecurityMiddleware",
    "corsheaders.middleware.CorsMiddleware",
    "envs_app.middleware.ApiLane",  # the API stops here; what follows is for pages
    "shepherd.csp.PolicyMiddleware",
    "whitenoise.middleware.WhiteNoiseMiddleware",
    "django.contrib.sessions.middleware.SessionMiddleware",
    "django.middleware.common.CommonMiddleware",
    "django.middleware.csrf.CsrfViewMiddleware",
    "django.contrib.auth.middleware.AuthenticationMiddleware",
    "django.contrib.messages.middleware.MessageMiddleware",
    "django.middleware.clickjacking.XFrameOptionsMiddleware",
    "axes.middleware.AxesMiddleware",
]
ROOT_URLCONF = "shepherd.urls"
WSGI_APPLICATION = "shepherd.wsgi.application"
TEMPLATES = [
    {
        "BACKEND": "django.template.backends.django.DjangoTemplates",
        "APP_DIRS": True,
        "OPTIONS": {
            "context_processors": [
                "django.template.context_processors.request",
                "django.contrib.auth.context_processors.auth",
                "django.contrib.messages.context_processors.messages",
            ]
        },
    }
]

DATABASES = {"default": env.database("DATABASE_URL", f"sqlite:///{DATA_DIR / 'shepherd.sqlite3'}")}
if DATABASES["default"]["ENGINE"] == "django.db.backends.sqlite3":
    DATABASES["default"]["OPTIONS"] = {
        "timeout": 20,
        "transaction_mode": "IMMEDIATE",
        "init_command": "PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; PRAGMA foreign_keys=ON;",
    }
else:  # a web process has more threads than a database takes connections: those at work share a few
    own = env.postgres(env.integer("SHEPHERD_DATABASE_POOL", 8, 1))
    DATABASES["default"] |= {"CONN_MAX_AGE": 0, "OPTIONS": own | DATABASES["default"].get("OPTIONS", {})}
DEFAULT_AUTO_FIELD = "django.db.models.BigAutoField"

REDIS_URL = env.redis("REDIS_URL")
CACHES = {"default": env.cache(REDIS_URL)}

STORAGES = {
    "default": {"BACKEND": "django.core.files.storage.FileSystemStorage"},
    "staticfiles": {"BACKEND": "django.contrib.staticfiles.storage.StaticFilesStorage"},
    "saves": env.storage("SHEPHERD_SAVES", env.options("SHEPHERD_SAVES_OPTIONS"), DATA_DIR / "saves"),
}

AUTH_USER_MODEL = "agents_app.User"
LANGUAGE_CODE = "en-us"
FORMAT_MODULE_PATH = ["shepherd.formats"]  # dates
TIME_ZONE = "UTC"
USE_TZ = True
STATIC_URL = "/static/"
STATIC_ROOT = DATA_DIR / "static"
WHITENOISE_USE_FINDERS = True

SECURE_CONTENT_TYPE_NOSNIFF = True
X_FRAME_OPTIONS = "DENY"
CONTENT_SECURITY_POLICY = {"DIRECTIVES": STRICT}

# Log-in to the admin: after so many wrong passwords for a name from an address, both wait together (django-axes).
PASSWORDS = "django.contrib.auth.password_validation"
LOGIN_REDIRECT_URL = "/admin/"  # who came to the log-in itself, and from no page
AUTHENTICATION_BACKENDS = ["axes.backends.AxesStandaloneBackend", "django.contrib.auth.backends.ModelBackend"]
AUTH_PASSWORD_VALIDATORS: list[dict[str, Any]] = [
    {"NAME": f"{PASSWORDS}.UserAttributeSimilarityValidator", "OPTIONS": {"user_attributes": ["name"]}},
    {"NAME": f"{PASSWORDS}.MinimumLengthValidator", "OPTIONS": {"min_length": 10}},
    {"NAME": f"{PASSWORDS}.CommonPasswordValidator"},
    {"NAME": f"{PASSWORDS}.NumericPasswordValidator"},
]
AXES_FAILURE_LIMIT = env.integer("SHEPHERD_WRONG_PASSWORDS", 5, 1)
AXES_COOLOFF_TIME = timedelta(minutes=15)
AXES_LOCKOUT_PARAMETERS = [["username", "ip_address"]]  # so that nobody can lock out somebody elsewhere
AXES_RESET_ON_SUCCESS = True
AXES_USERNAME_FORM_FIELD = "username"
AXES_CLIENT_IP_CALLABLE = "envs_app.requests.address_of"
AXES_LOCKOUT_CALLABLE = "agents_app.admin.audit.locked_out"
AXES_ENABLE_ADMIN = False  # agents_app.admin.audit shows it
AXES_VERBOSE = False
AUDIT_DAYS = env.integer("SHEPHERD_AUDIT_DAYS", 365, 1)  # how long actions in the admin and log-ins are kept
if BEHIND_TLS:
    SECURE_PROXY_SSL_HEADER = ("HTTP_X_FORWARDED_PROTO", "https")
    SECURE_REDIRECT_EXEMPT = ["^(healthz|readyz|metrics)$"]  # asked by machines beside this one
    SECURE_SSL_REDIRECT = SESSION_COOKIE_SECURE = CSRF_COOKIE_SECURE = True
    SECURE_HSTS_SECONDS = 31_536_000
    SECURE_HSTS_INCLUDE_SUBDOMAINS = SECURE_HSTS_PRELOAD = True

# What meets the executions: dotted names, so that no layer imports the one above it.
SHEPHERD_FLEET = "envs_app.fleet.TransportFleet"
TRANSPORT = env.choice("SHEPHERD_TRANSPORT", ["redis", "local"] if REDIS_URL else ["local", "redis"])

MAX_EXECUTIONS = env.integer("SHEPHERD_MAX_EXECUTIONS", 500, 1)  # on this machine, all agents together
SLOTS = env.integer("SHEPHERD_SLOTS", 32, 1)  # executions of a Celery worker
IDLE_SECONDS = env.integer("SHEPHERD_IDLE_SECONDS", 30 * 60, 1)  # an execution without steps is saved and ended
RECLAIM_SECONDS = env.integer("SHEPHERD_RECLAIM_SECONDS", 120, 1)  # a silent session may lose its execution to another
SESSION_DAYS = env.integer("SHEPHERD_SESSION_DAYS", 30, 1)  # a session without steps is closed
STEP_TIMEOUT = env.integer("SHEPHERD_STEP_TIMEOUT", 20, 1)  # seconds until a step is answered with a 503
SAVES_KEPT = env.integer("SHEPHERD_SAVES_KEPT", 5, 1)  # per execution; the best one of a run is always kept
MAX_BODY_BYTES = env.integer("SHEPHERD_MAX_BODY_BYTES", 8 * 2**20, 1024)
METRICS_KEY = env.text("SHEPHERD_METRICS_KEY")
WRONG_KEYS = env.integer("SHEPHERD_WRONG_KEYS", 20)  # throttles, a minute; 0: none
LOGINS = env.integer("SHEPHERD_LOGINS", 6000)
PUBLISHABLE_LOGINS = env.integer("SHEPHERD_PUBLISHABLE_LOGINS", 120)
PUBLISHABLE_STEPS = env.integer("SHEPHERD_PUBLISHABLE_STEPS", 20_000)  # from an address, which a café's visitors share
PUBLISHABLE_SESSION_STEPS = env.integer("SHEPHERD_PUBLISHABLE_SESSION_STEPS", 6000)
WEB_WORKERS = env.integer("SHEPHERD_WEB_WORKERS", min(4, env.cores()), 1)
WEB_THREADS = env.integer("SHEPHERD_WEB_THREADS", 128, 1)
MIN_FREE_MB = env.integer("SHEPHERD_MIN_FREE_MB", 200)  # `serve` does not start with less room on the disk
LOG_DIR = None if env.choice("SHEPHERD_LOG", ["files", "stderr"]) == "stderr" else DATA_DIR / "logs"
DATA_UPLOAD_MAX_MEMORY_SIZE = MAX_BODY_BYTES

# Bored in the city (frontend/bored/): which agent, and whom the page may ask beside this server; empty: nobody.
BORED_KEY = env.text("SHEPHERD_BORED_KEY")  # a publishable one
BORED_TILES = env.text("SHEPHERD_BORED_TILES", "https://tile.openstreetmap.org/{z}/{x}/{y}.png")
BORED_ATTRIBUTION = env.text("SHEPHERD_BORED_ATTRIBUTION", "© OpenStreetMap contributors")
BORED_ROUTING = env.text("SHEPHERD_BORED_ROUTING", "https://routing.openstreetmap.de/routed-foot")

LOGGING = logging_config(
    env.choice("SHEPHERD_LOG_LEVEL", ["INFO", "DEBUG", "WARNING", "ERROR"]),
    env.choice("SHEPHERD_LOG_FORMAT", ["json", "console"]),
)

# Browsers may call the API from any page: it takes keys in a header, never cookies.
CORS_URLS_REGEX = r"^/(api|shepherd)/"
CORS_ALLOWED_ORIGINS = [origin for origin in env.words("SHEPHERD_CORS_ORIGINS", "*") if origin != "*"]
CORS_ALLOW_ALL_ORIGINS = "*" in env.words("SHEPHERD_CORS_ORIGINS", "*")
CORS_EXPOSE_HEADERS = ["Retry-After"]

REST_FRAMEWORK = {
    "DEFAULT_AUTHENTICATION_CLASSES": [],
    "DEFAULT_PERMISSION_CLASSES": [],
    "DEFAULT_RENDERER_CLASSES": ["envs_app.renderers.OrjsonRenderer"],
    "DEFAULT_PARSER_CLASSES": ["rest_framework.parsers.JSONParser"],
    "DEFAULT_CONTENT_NEGOTIATION_CLASS": "envs_app.renderers.OneForm",
    "DEFAULT_METADATA_CLASS": None,
    "DEFAULT_SCHEMA_CLASS": "drf_spectacular.openapi.AutoSchema",
    "EXCEPTION_HANDLER": "envs_app.problems.exception_handler",
    "UNAUTHENTICATED_USER": None,
}
SPECTACULAR_SETTINGS = {
    "TITLE": "Shepherd",
    "DESCRIPTION": "Reinforcement learning as a service: send observations and rewards, get actions. See docs/api.md.",
    "VERSION": "1",
    "OAS_VERSION": "3.1.0",
    "SERVE_INCLUDE_SCHEMA": False,
    "POSTPROCESSING_HOOKS": ["drf_spectacular.hooks.postprocess_schema_enums", "envs_app.openapi.add_components"],
    "SWAGGER_UI_DIST": "SIDECAR",
    "SWAGGER_UI_FAVICON_HREF": "SIDECAR",
}
