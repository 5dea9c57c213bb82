#pragma once

#include <string>
#include <utility>
#include <vector>

#include "apps/documents/fingerprint.hpp"
#include "apps/results/checkpoint_archive.hpp"
#include "apps/results/output_folder.hpp"

namespace orbid::apps {

/// What a run has finished within its estimate, in `checkpoint.bin` of the folder: a killed or interrupted run
/// continues from it and ends with the same bytes as an undisturbed one. It is removed when the estimate is complete.
///
/// A file with another fingerprint, of another program, or unreadable counts as absent.
class Checkpoint {
public:
    /// @param fingerprint  of what the estimate depends on.
    Checkpoint(OutputFolder& folder, const Fingerprint& fingerprint);

    /// Reads the value stored under a name.
    /// @return whether it exists.
    template <class T>
    [[nodiscard]] bool recall(const std::string& name, T& value) const {
        const std::string* bytes = find(name);
        if (bytes == nullptr) return false;
        try {
            Archive archive{std::string_view(*bytes)};
            archive(value);
            if (archive.at_end()) return true;
        } catch (const DamagedCheckpoint&) {
            // Stored by a build with other layouts of values: computed again.
        }
        value = T{};
        return false;
    }

    /// Stores a value under a name, in place of the one that it has; it is complete in the folder when this returns.
    template <class T>
    void keep(const std::string& name, T& value) {
        std::string bytes;
        Archive archive(bytes);
        archive(value);
        keep_bytes(name, std::move(bytes));
    }

    /// Removes the file at the end.
    void remove();

private:
    [[nodiscard]] const std::string* find(const std::string& name) const;
    void keep_bytes(const std::string& name, std::string bytes);

    OutputFolder& folder_;
    std::string fingerprint_;
    std::vector<std::pair<std::string, std::string>> kept_;
};

}  // namespace orbid::apps
