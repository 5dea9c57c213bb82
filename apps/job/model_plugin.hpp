#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "models/equations/equations.hpp"
#include "models/system/kernel.hpp"

namespace orbid::apps {

/// A model written in a job as compiled code, or the reason why there is none.
struct CompiledModel {
    std::shared_ptr<const models::Kernel> kernel;  ///< nothing: see `why`
    bool cached = false;                           ///< found in the cache, not compiled
    std::string why;
};

/// Folder of compiled models: $XDG_CACHE_HOME/orbid, else ~/.cache/orbid; nothing without a home.
[[nodiscard]] std::optional<std::filesystem::path> plugin_cache();

/// The compiled code of a model: from the cache, else compiled into it.
///
/// A file in the cache is named by the SHA-256 of all it depends on: source, version of orbid, content of its headers,
/// compiler, flags, processor. It ends with its own SHA-256 and is compiled again if that does not fit. Files appear
/// whole, in a folder that only the user may write to; nothing is written elsewhere. Never throws.
[[nodiscard]] CompiledModel compiled_model(const std::shared_ptr<const models::Equations>& equations);

/// Whether compiled_model() would find the model in the cache (true), could compile it (false), or the reason why
/// neither.
struct CompiledModelState {
    bool possible = false;
    bool cached = false;
    std::string why;
};
[[nodiscard]] CompiledModelState compiled_model_state(const models::Equations& equations);

}  // namespace orbid::apps
