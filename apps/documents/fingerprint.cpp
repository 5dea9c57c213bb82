#include "apps/documents/fingerprint.hpp"

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <memory>
#include <set>
#include <stdexcept>
#include <system_error>

#include <fmt/format.h>
#include <openssl/evp.h>
#include <nlohmann/json.hpp>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_value.hpp"

namespace orbid::apps {
namespace {

/// One running SHA-256.
class Digest {
public:
    Digest() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
        require(context_ != nullptr && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1);
    }

    void add(std::string_view bytes) { require(EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size()) == 1); }

    [[nodiscard]] std::string hexadecimal() {
        unsigned char bytes[EVP_MAX_MD_SIZE];
        unsigned int size = 0;
        require(EVP_DigestFinal_ex(context_.get(), bytes, &size) == 1);
        std::string text;
        for (unsigned int i = 0; i < size; ++i)
            text += fmt::format("{:02x}", bytes[i]);
        return text;
    }

private:
    static void require(bool ok) {
        if (!ok) throw std::runtime_error("OpenSSL cannot compute SHA-256");
    }

    std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

std::string hash_of(const std::vector<std::pair<std::string, std::string>>& keys) {
    Digest digest;
    for (const auto& [key, value] : keys) {
        digest.add(fmt::format("{} {} ", key.size(), value.size()));
        digest.add(key);
        digest.add(value);
    }
    return digest.hexadecimal();
}

const std::string* find(const Fingerprint& in, const std::string& key) {
    const auto at = std::find_if(in.keys.begin(), in.keys.end(), [&](const auto& entry) { return entry.first == key; });
    return at == in.keys.end() ? nullptr : &at->second;
}

}  // namespace

std::string sha256(std::string_view bytes) {
    Digest digest;
    digest.add(bytes);
    return digest.hexadecimal();
}

std::string sha256_of_file(const std::filesystem::path& path) {
    errno = 0;
    std::ifstream file(path, std::ios::binary);
    Digest digest;
    std::string buffer(std::size_t{1} << 20, '\0');  // 1 MiB: reading, not hashing, is then the slower part
    while (file) {
        file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
        digest.add(std::string_view(buffer).substr(0, static_cast<std::size_t>(file.gcount())));
    }
    if (!file.eof() || file.bad())
        throw FileUnreadable(fmt::format("cannot read {}: {}", path.string(), std::generic_category().message(errno)));
    return digest.hexadecimal();
}

Fingerprint fingerprint(std::vector<std::pair<std::string, std::string>> keys) {
    std::set<std::string> seen;
    for (const auto& [key, value] : keys)
        if (!seen.insert(key).second)
            throw std::invalid_argument(fmt::format("fingerprint: key {} is given twice; keys must be unique", key));
    std::string hash = hash_of(keys);
    return {std::move(hash), std::move(keys)};
}

std::optional<FingerprintDifference> compare(const Fingerprint& first, const Fingerprint& second) {
    if (first.sha256 == second.sha256) return std::nullopt;
    for (const auto& [key, value] : first.keys) {
        const std::string* other = find(second, key);
        if (other == nullptr) return FingerprintDifference{key, value, std::nullopt};
        if (*other != value) return FingerprintDifference{key, value, *other};
    }
    for (const auto& [key, value] : second.keys)
        if (find(first, key) == nullptr) return FingerprintDifference{key, std::nullopt, value};
    return FingerprintDifference{"sha256", first.sha256, second.sha256};
}

std::string description(const FingerprintDifference& difference, std::string_view first_is,
                        std::string_view second_is) {
    // Values can be whole parts of a job; enough of them to recognise the difference, not pages.
    const auto shown = [](const std::optional<std::string>& value) {
        constexpr std::size_t longest = 120;
        if (!value) return std::string("absent");
        return value->size() <= longest ? *value : value->substr(0, longest) + "...";
    };
    return fmt::format("{} is {} in {}, {} in {}", difference.key, shown(difference.first), first_is,
                       shown(difference.second), second_is);
}

std::string to_text(const Fingerprint& value) {
    nlohmann::ordered_json keys = nlohmann::ordered_json::array();
    for (const auto& [key, text] : value.keys)
        keys.push_back({key, text});
    return nlohmann::ordered_json{{"sha256", value.sha256}, {"keys", keys}}.dump(
        -1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::optional<Fingerprint> fingerprint_from_text(std::string_view text) {
    const auto json = json_value_or_discarded(text);
    if (!json.is_object() || !json.contains("sha256") || !json["sha256"].is_string() || !json.contains("keys") ||
        !json["keys"].is_array()) {
        return std::nullopt;
    }
    Fingerprint read{json["sha256"].get<std::string>(), {}};
    for (const auto& pair : json["keys"]) {
        if (!pair.is_array() || pair.size() != 2 || !pair[0].is_string() || !pair[1].is_string()) return std::nullopt;
        read.keys.emplace_back(pair[0].get<std::string>(), pair[1].get<std::string>());
    }
    if (hash_of(read.keys) != read.sha256) return std::nullopt;
    return read;
}

}  // namespace orbid::apps
