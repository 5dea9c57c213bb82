#include "apps/documents/schema_page.hpp"

#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace orbid::apps {

namespace {

/// A bar would end the cell of a table.
std::string cell(std::string text) {
    for (std::size_t at = text.find('|'); at != std::string::npos; at = text.find('|', at + 2))
        text.insert(at, 1, '\\');
    return text;
}

std::string code(std::string_view text) {
    return fmt::format("`{}`", text);
}

std::string choices(const std::vector<std::string>& names) {
    std::vector<std::string> quoted;
    quoted.reserve(names.size());
    for (const std::string& name : names)
        quoted.push_back(fmt::format("`\"{}\"`", name));
    return fmt::format("{}", fmt::join(quoted, ", "));
}

class Page {
public:
    explicit Page(std::string& text) : text_(text) {}

    void object(const ObjectSchema& form, const std::string& path) {
        text_ += "| key | value | default | |\n|---|---|---|---|\n";
        for (const KeySchema& entry : form.keys)
            if (entry.refused.empty()) row(entry);
        if (form.entries) text_ += fmt::format("| *{}* | {} | | |\n", form.entries->names, kinds(*form.entries->value));
        if (!form.exactly_one.empty())
            text_ += fmt::format("\nExactly one of `{}` must be there.\n", fmt::join(form.exactly_one, "`, `"));
        text_ += '\n';
        for (const KeySchema& entry : form.keys)
            if (entry.refused.empty()) below(entry.value, path.empty() ? entry.key : path + "." + entry.key);
        if (form.entries) below(*form.entries->value, path + ".NAME");
    }

    /// What several keys share, each once.
    void shared() {
        for (std::size_t i = 0; i < shared_.size(); ++i) {
            const ValueSchema value = shared_[i];
            text_ += fmt::format("## {}\n\n{}.\n\n", value.name, kinds_unnamed(value));
            inner(value, value.name);
        }
    }

private:
    void row(const KeySchema& entry) {
        std::string notes = entry.text;
        if (!entry.unit.empty()) notes = fmt::format("[{}] {}", entry.unit, notes);
        if (entry.only_with) notes += fmt::format(" With {}.", condition(*entry.only_with));
        if (entry.required_with) notes += fmt::format(" Required with {}.", condition(*entry.required_with));
        if (entry.required_unless) notes += fmt::format(" Required without {}.", code(*entry.required_unless));
        if (entry.never_beside) notes += fmt::format(" Not beside {}.", code(*entry.never_beside));
        const std::string default_value = entry.required                ? "required"
                                          : entry.default_value.empty() ? ""
                                                                        : code(entry.default_value);
        text_ += fmt::format("| {} | {} | {} | {} |\n", code(entry.key), kinds(entry.value), cell(default_value),
                             cell(notes));
    }

    static std::string condition(const Condition& condition) {
        if (!condition.or_key.empty()) return code(condition.key) + " or " + code(condition.or_key);
        if (condition.values.empty()) return code(condition.key);
        return fmt::format("`{}` {}", condition.key, choices(condition.values));
    }

    std::string kinds(const ValueSchema& value) {
        if (value.name.empty()) return kinds_unnamed(value);
        const bool known = std::any_of(shared_.begin(), shared_.end(),
                                       [&](const ValueSchema& other) { return other.name == value.name; });
        if (!known) shared_.push_back(value);
        return fmt::format("[{0}](#{0})", value.name);
    }

    std::string kinds_unnamed(const ValueSchema& value) {
        if (value.anything) return "anything";
        std::vector<std::string> forms;
        if (value.number) {
            const std::string limits = rule(*value.number);
            const bool says_number = value.number->whole || !value.number->only.empty();
            forms.push_back(limits.empty() ? "number" : says_number ? limits : "number " + limits);
        }
        if (value.boolean) forms.emplace_back("`true`, `false`");
        if (value.text) forms.push_back(value.text->choices.empty() ? value.text->rule : choices(value.text->choices));
        if (value.list) forms.push_back(list(*value.list));
        if (value.shares_object())
            forms.push_back(kinds(value.shared_object()));
        else if (value.object)
            forms.emplace_back(value.object->entries ? "object by name" : "object");
        if (value.null) forms.emplace_back("`null`");
        return cell(fmt::format("{}", fmt::join(forms, ", or ")));
    }

    std::string list(const ListSchema& form) {
        std::string counted = form.unique ? "list of different: " : "list of: ";
        if (form.fewest > 0 && form.most == form.fewest) counted = fmt::format("list of {}: ", form.fewest);
        return counted + kinds(*form.item);
    }

    /// Sections for the objects within a value that has no name of its own.
    void below(const ValueSchema& value, const std::string& path) {
        if (value.name.empty()) inner(value, path);
    }

    void inner(const ValueSchema& value, const std::string& path) {
        if (value.list) below(*value.list->item, path + "[]");
        if (!value.object || value.shares_object()) return;
        // Names with plain numbers, say, are described by the cell already.
        const bool simple = value.object->keys.empty() && value.object->entries &&
                            value.object->entries->value->object == nullptr &&
                            value.object->entries->value->list == std::nullopt;
        if (simple) {
            text_ += fmt::format("`{}`: named after {}; each {}.\n\n", path, value.object->entries->names,
                                 kinds(*value.object->entries->value));
            return;
        }
        if (value.name.empty())
            text_ += fmt::format("{} {}\n\n", path.find('.') == std::string::npos ? "##" : "###", path);
        object(*value.object, path);
    }

    std::string& text_;
    std::vector<ValueSchema> shared_;
};

}  // namespace

std::string reference_page(const ValueSchema& description, std::string_view title, std::string_view opening) {
    std::string text = fmt::format("# {}\n\n{}\n\n", title, opening);
    Page page(text);
    if (description.object) page.object(*description.object, "");
    page.shared();
    // One line break at the end of the file.
    while (text.ends_with("\n\n"))
        text.pop_back();
    return text;
}

}  // namespace orbid::apps
