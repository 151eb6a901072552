"""Every dialog of the window: a new one is a request, a file and a line here."""

from __future__ import annotations

from instdrive_app.panels.dialogs import DialogRecord, about, changed_scene, command_palette, dropped, file_browser, other_save, reassign, recovery, rename, set_class, shortcuts, split, too_large, turn_upright, unsaved
from instdrive_app.panels.dialogs import cleanup
from instdrive_app.session.requests import (
    AskChangedScene,
    AskClass,
    AskExport,
    AskName,
    AskOtherSave,
    AskPath,
    AskReassign,
    AskSplit,
    AskTooLarge,
    AskUnsaved,
    AskUp,
    OfferCleanup,
    OfferRecovery,
    ReceiveDrop,
    ShowAbout,
    ShowPalette,
    ShowShortcuts,
)

DIALOGS = (
    DialogRecord(file_browser.TITLE, "ICON_FA_FOLDER_OPEN", file_browser.FileBrowser, (AskPath, AskExport)),
    DialogRecord(rename.TITLE, "ICON_FA_PEN", rename.RenameDialog, (AskName,)),
    DialogRecord(set_class.TITLE, "ICON_FA_TAG", set_class.ClassDialog, (AskClass,)),
    DialogRecord(split.TITLE, "ICON_FA_OBJECT_UNGROUP", split.SplitDialog, (AskSplit,)),
    DialogRecord(reassign.TITLE, "ICON_FA_RIGHT_LEFT", reassign.ReassignDialog, (AskReassign,)),
    DialogRecord(shortcuts.TITLE, "ICON_FA_KEYBOARD", shortcuts.ShortcutSheet, (ShowShortcuts,)),
    DialogRecord(about.TITLE, "ICON_FA_CIRCLE_INFO", about.AboutDialog, (ShowAbout,)),
    DialogRecord(command_palette.TITLE, "ICON_FA_MAGNIFYING_GLASS", command_palette.CommandPalette, (ShowPalette,)),
    DialogRecord(unsaved.TITLE, "ICON_FA_FLOPPY_DISK", unsaved.UnsavedDialog, (AskUnsaved,)),
    DialogRecord(recovery.TITLE, "ICON_FA_LIFE_RING", recovery.RecoveryDialog, (OfferRecovery,)),
    DialogRecord(dropped.TITLE, "ICON_FA_FILE_IMPORT", dropped.DroppedDialog, (ReceiveDrop,)),
    DialogRecord(changed_scene.TITLE, "ICON_FA_CODE_COMPARE", changed_scene.ChangedSceneDialog, (AskChangedScene,)),
    DialogRecord(other_save.TITLE, "ICON_FA_USER_PEN", other_save.OtherSaveDialog, (AskOtherSave,)),
    DialogRecord(too_large.TITLE, "ICON_FA_MEMORY", too_large.TooLargeDialog, (AskTooLarge,)),
    DialogRecord(cleanup.TITLE, "ICON_FA_BROOM", cleanup.CleanupDialog, (OfferCleanup,)),
    DialogRecord(turn_upright.TITLE, "ICON_FA_ARROW_UP", turn_upright.TurnUprightDialog, (AskUp,)),
)
